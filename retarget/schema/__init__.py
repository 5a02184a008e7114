"""Files that people write. In: strict YAML. Out: frozen models, or all problems of the file. Imports only flat
modules."""
