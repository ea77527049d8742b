"""Robot programs drawn by grammars, driven by interpreters written from the makers' manuals, before and after a
correction. Nothing here reads or imports the reader of the product; it is called as a person calls it."""
