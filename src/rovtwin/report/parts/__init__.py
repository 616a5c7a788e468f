"""What all reports are made of: looks of figures, panels, force curves with bands, pages, tables, verdicts."""
