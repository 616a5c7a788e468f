"""What has changed since the vehicle was identified: found while it flies, and over runs."""
