"""The cut: engagement of tool and stock, forces, stability, tool life, cost."""
