"""Photos: decoding, segmentation, cropping, and comparison with views of known objects."""
