"""Files that people write: strict YAML, read as models of a profile, priorities, a performer and a scene. In: a path or
a name. Out: frozen models, or all problems of the file. Imports nothing of `retarget` but what lies flat in it."""
