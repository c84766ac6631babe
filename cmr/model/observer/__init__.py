"""The model drawn towards what sensors say: prediction errors of recorded drives, for many candidates at once.

`observer` prepares and composes what is compiled, `drives` puts recorded drives side by side; the text of what is
compiled is in `loops`, what that counts with in `helpers`.
"""
