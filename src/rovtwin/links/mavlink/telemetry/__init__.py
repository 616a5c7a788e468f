"""What an ArduSub says of itself: messages, and which peer gets which when."""
