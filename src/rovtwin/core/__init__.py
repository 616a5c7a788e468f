"""What all packages share: frames, integration, Block, what flows between blocks, Log, errors.

Imports nothing else of rovtwin. `core.numerics` configures JAX and is imported first by every module that computes.
"""
