"""The report of an identification: figures, tables, and what it says in words."""
