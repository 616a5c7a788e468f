"""What an ArduSub decides and keeps, without sockets: modes and arming, GUIDED, missions, parameters, pilots."""
