"""Vehicle files side by side: tables, force curves and a page."""
