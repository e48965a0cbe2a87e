"""What a person sees: tables, run folders, recordings."""
