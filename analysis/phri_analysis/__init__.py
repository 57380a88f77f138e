"""Trials of physical human-robot interaction: bags or lockstep runs -> measures -> pictures -> report."""

__version__ = "0.1.0"
