"""Fused training steps: samples, forward, loss, backward and weight gradients in one kernel; one optimizer kernel."""
