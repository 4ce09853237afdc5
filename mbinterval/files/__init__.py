"""Files: whole or not at all, by whom they are, and the formats that pixels are kept in."""
