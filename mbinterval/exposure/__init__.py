"""What happens while the shutter is open: poses, motion segments, stretches and mirrors."""
