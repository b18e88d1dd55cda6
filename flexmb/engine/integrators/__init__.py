"""The methods that a scene can name, one in a file.

A method is a file here with a table `METHODS`, and a line of words in `model.scenes.dynamics`; the
contract is in `engine.method`; `engine.method_selection` finds them.
"""
