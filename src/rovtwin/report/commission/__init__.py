"""The certificate of a commissioning, as a page and as a PDF, of plain data."""
