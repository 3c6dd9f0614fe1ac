"""Turn segments of a scan into the surfaces of a scene."""
