"""Collision observers and pairs to ignore for a robot, proposed from its body file.

`proposals` gives every link with geometry a shape, `survey` looks how near these shapes come to each other, `verdicts`
says which pairs need no check and why, `fragment` writes it all as a part of a robot profile.
"""
