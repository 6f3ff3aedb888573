"""The paper's evaluation protocol and its tests of disentanglement."""
