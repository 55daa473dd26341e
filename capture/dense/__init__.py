"""Dense points of a reconstruction on the CPU: depth by plane sweep, kept where several views agree."""
