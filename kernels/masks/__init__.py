"""Object masks: their areas, moments, borders, overlaps; decision forests that find them."""
