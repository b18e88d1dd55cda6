"""The integration methods that a scene can name, one in a file.

A method is a file here with a table `METHODS`, and an entry in `model.scenes.dynamics` with its
options. `engine.method` has the contract; `engine.method_selection` finds the files.
"""
