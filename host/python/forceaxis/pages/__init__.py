"""Pages: HTML files about a folder of experiments, a design and a tuning. Verbs write them."""
