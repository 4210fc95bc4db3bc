"""The paper's theorem in numbers: Lyapunov function, fixed-time bounds."""
