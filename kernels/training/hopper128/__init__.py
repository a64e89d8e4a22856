"""A fused training step by warpgroups (`wgmma`), for 128 neurons a layer, in one pass or two."""
