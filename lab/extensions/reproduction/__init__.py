"""What four sources print, computed again: their tables, figures and worked examples, item by item."""
