"""Presentation of results as text, pages, pictures and files, from shared tables and charts."""
