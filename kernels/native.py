"""Native text: C++ and CUDA that `wp.func_native` takes."""


def both(cpu_text: str, cuda_text: str) -> str:
    """One text for the two compilers."""
    return f"#if defined(__CUDA_ARCH__)\n{cuda_text}\n#else\n{cpu_text}\n#endif\n"
