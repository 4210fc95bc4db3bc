"""Pure: from motion-capture frames to the state the controller uses."""
