"""What a person is told of an adapter that gives back what is sent."""

ECHOES = "the adapter echoes what is sent: it works, but costs time in every exchange; switch its local echo off"
