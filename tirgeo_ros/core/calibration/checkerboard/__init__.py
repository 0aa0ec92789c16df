"""Find checkerboards in thermal pictures, and estimate a lens or a pose from them."""
