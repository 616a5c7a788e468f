"""Links: one face, `core.link.Link`, to any vehicle; and servers that let the twin speak a vendor's protocol.

Depends on core and vehicle only; the twin is handed over as an argument.
"""
