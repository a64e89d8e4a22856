"""A fused training step by warpgroups (`wgmma`), for 64 neurons a layer."""
