"""Pages of the console: each view is a Python function that builds its elements, and a module in `static` that draws.

A view's elements are custom elements (`<rov-scene>`), which come to life wherever and whenever NiceGUI puts them.
"""
