"""Random robot programs generated from grammars, executed before and after a correction by interpreters written from
the makers' manuals. Nothing here imports the program reader of rig, which is called through its commands.
"""
