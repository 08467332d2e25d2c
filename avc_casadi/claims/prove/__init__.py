"""Proofs by interval arithmetic, loaded when somebody asks for one."""
