"""Images as they come: decoded, segmented, cropped, and compared with views of known objects."""
