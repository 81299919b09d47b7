"""What the machine is: control, drives, spindle."""
