"""The whole chain: from a scene over flexible bodies and the compiled system to runs, files,
pictures.

The command line and the Python API use the same functions.
"""
