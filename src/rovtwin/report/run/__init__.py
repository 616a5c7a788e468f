"""The report of a run from its log: figures and what each needs, tables, verdict, the page; runs side by side."""
