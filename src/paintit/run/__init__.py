"""One run folder: what is in it, who may write to it, how it is painted, resumed and exported."""
