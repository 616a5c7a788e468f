"""Commands that fly, serve and record, and those that look at what came out."""
