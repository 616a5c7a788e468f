"""What clients of a drone ask and are answered: requests, HTTP, sockets."""
