"""How to render: every knob, its range, and what does not go together."""
