"""``jaxrender check CAPTURE``: what is wrong with a capture, before anything is fitted to it.

``check`` goes through it, ``conventions`` finds how cameras, mesh and light are meant, ``places``
where the object lies, ``mend`` writes what was found into the config, ``mesh`` says what is wrong
with a mesh.  ``photographs`` judges the pictures, and ``page`` shows all of it.
"""
