"""An exposure as the kernels read it: vertices, paths, looks and identities."""
