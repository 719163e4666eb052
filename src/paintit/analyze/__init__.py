"""Numbers about the method: how fast each frequency is learned, how far the gradients of near views agree."""
