"""What a run says about itself: metrics, words and JSON."""
