"""What tests share: scenes, cases, files, kernels alone, processes."""
