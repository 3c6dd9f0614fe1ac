"""Panel images: specular paths over flat surfaces."""
