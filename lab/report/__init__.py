"""What a person sees: documents, pages, charts, scenes, recordings."""
