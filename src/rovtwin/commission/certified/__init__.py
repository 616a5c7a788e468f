"""What a commissioning leaves: the certificate's figures, the bundle of all evidence, and its verification."""
