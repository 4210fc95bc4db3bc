"""Live page for operators: serves it, follows the vehicles over MQTT, sends its commands. A process of its own."""
