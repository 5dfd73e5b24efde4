"""Pages: HTML files about a folder of experiments and about a tuning. Verbs write them."""
