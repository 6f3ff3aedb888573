"""Activities beside editing: rendering, playing, fitting, segmenting, painting, exporting."""
