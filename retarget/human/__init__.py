"""The first stage: a performer's sensors move a virtual human of their size."""
