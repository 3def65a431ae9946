"""Presentation of results: text, pages, pictures and files of one list of tables and charts."""
