"""What a render gives: pixels, layers, deep images and events, and the files that they go to."""
