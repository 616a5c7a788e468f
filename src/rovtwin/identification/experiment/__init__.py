"""Which tests to fly: what each would tell (`information`), and which of them tell most together (`choice`).

Depends on the joint estimate, whose parameters, prior and derivatives it uses.
"""
