"""Many frames: which are there, who renders the others, and what is written of them."""
