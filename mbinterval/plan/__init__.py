"""How an exposure is rendered: effects that are called for, stages, sizes and memory."""
