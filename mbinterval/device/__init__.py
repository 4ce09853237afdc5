"""The OpenCL device: choosing it, building programs for it, and the records shared with it."""
