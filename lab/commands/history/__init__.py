"""``lab history``: what moved between runs and since when; which arms are good and due."""
