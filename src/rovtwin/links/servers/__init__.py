"""What servers of any protocol share: the vehicle they serve, commands of their clients, a process, TCP ports."""
