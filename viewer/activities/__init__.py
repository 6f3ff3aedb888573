"""Activities beside editing: rendering, playing, fitting, segmenting, exporting. Each takes jobs and an editor."""
