"""Files that users write, as strict models. No device, no clock."""
