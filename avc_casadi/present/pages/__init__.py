"""Printed output of each command: a headline and rows, a file a group of commands."""
