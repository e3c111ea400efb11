"""The compiler: numerical functions of Python, with declared types, as machine code by LLVM."""
