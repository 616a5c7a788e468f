"""What clients ask and are answered: peers, sockets, MAVLink's micro-services."""
