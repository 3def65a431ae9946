"""Files of text: lines to fields, fields to the rows of a table."""
