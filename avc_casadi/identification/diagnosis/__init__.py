"""Why a loop buzzes."""
