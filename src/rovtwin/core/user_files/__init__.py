"""Files that people write and read, and what stands in them: YAML read strictly, pydantic models, quantities, JSON."""
