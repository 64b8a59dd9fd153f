"""Valve, chamber, transducer and the pressure controller."""
