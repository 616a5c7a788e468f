"""Commands on vehicle files."""
