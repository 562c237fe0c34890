"""What happens: fields, flows, motion, perception and the world that joins them."""
