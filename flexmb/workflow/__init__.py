"""The whole chain in one call: scene to flexible bodies to system to run to files and pictures.

The command line and the Python API use the same functions.
"""
