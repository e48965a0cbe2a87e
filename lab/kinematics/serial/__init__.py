"""Serial arms: Denavit-Hartenberg chains, their derivatives, batches of them."""
