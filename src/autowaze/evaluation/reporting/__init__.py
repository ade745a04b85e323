"""A report as sections of tables, pictures and text; written as one HTML page or as Markdown."""
