"""The paper's section V in the closed loop: which walks, what stands in their way, and what comes of them."""
