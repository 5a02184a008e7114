"""What a run says about itself: metrics, JSON, an HTML page and pictures."""
