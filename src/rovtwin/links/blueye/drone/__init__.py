"""What a drone keeps in mind and says of itself, without sockets."""
