"""The mock Qualisys server: camera, session, packets and sockets."""
