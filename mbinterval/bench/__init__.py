"""Speed: seconds, work and error of the methods on scenes, measured and compared."""
