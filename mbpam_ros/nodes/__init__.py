"""Thin rclpy adapters: parameters, messages to SI arrays and back, timers, diagnostics."""
