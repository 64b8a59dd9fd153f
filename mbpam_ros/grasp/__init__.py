"""Grasp modes, mode selection and the arbitration state machine."""
